"""What the writer is made of: its chunks, and the file that it owns."""
