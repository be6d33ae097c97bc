"""Rules and condensations that the default is compared with (docs/baselines.md)."""
