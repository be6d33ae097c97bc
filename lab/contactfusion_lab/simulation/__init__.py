"""Simulated robots that give readings as real ones would, and the truth apart from them."""
