"""A base pushes an object to a target by contact feedback."""
