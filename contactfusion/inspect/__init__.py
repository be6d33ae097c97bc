"""What a recording holds, and a first configuration for it."""
