"""Searches parameters of reactive pushing in a quick model, and confirms them in the slow one."""
