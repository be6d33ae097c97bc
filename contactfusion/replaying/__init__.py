"""Replay: a configuration on a recording, its contacts beside what was recorded."""
