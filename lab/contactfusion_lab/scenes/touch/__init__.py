"""A hand touches an object that does not move."""
