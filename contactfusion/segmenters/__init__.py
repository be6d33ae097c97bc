"""Segmenters: which pixels of an image belong to the object that is pushed."""
