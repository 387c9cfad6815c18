"""Model and integrators for the reproduction of a Cartesian robot arm study."""
