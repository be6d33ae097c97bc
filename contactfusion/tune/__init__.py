"""Searches the settings that detect labelled contacts best."""
