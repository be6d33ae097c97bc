"""Trains the networks that perceive contact from labelled trials."""
