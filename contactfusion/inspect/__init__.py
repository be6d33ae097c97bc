"""Contents of a recording, and a first configuration for it."""
