"""Reproduction of a Cartesian robot arm study: its model, its integrators, its report."""
