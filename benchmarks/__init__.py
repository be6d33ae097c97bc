"""The speed of the hypothesis space against its peers: `python -m benchmarks`."""
