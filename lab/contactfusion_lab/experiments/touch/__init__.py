"""`experiment touch`: the first paper's table, by modality and rule (F §VI-A, Table I)."""
