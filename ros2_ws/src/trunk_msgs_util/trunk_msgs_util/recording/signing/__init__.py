"""Who vouches for a recording: Ed25519 keys, and signatures over its content."""
