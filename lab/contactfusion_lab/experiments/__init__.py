"""Experiments: figures that the framework is rated by."""
