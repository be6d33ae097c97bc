"""Identification of efforts, payloads and wrists from recordings without contact."""
