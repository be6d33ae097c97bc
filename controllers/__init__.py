"""From contacts to motion."""
