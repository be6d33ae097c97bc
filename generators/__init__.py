"""From readings to hypotheses: one module a generator, each a plug-in by entry point."""
