"""Why there is a contact, or none, and what each source is worth."""
