"""`experiment grasp`: a hand that corrects itself by touch, by sources and rule (F §VI-B)."""
