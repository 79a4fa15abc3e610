"""The conformance kits: what a law, and a plant, must hold to."""
