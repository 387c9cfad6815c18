"""Reproducible reports: notebooks record values, pages quote them, a check finds what changed."""
