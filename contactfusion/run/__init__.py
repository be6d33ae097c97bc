"""Plays recordings and scenes to the pipeline of a configuration, and keeps what is found."""
