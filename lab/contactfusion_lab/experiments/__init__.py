"""Experiments: figures that the framework is judged by."""
