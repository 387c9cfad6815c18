"""What a notebook needs."""
