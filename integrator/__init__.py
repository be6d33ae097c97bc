"""From hypotheses to contacts: the space, the rules, the condensations, and `integrator.py`."""
