"""Why a contact was told or not, and what each source is worth."""
