"""A reproducible report: notebooks that record, pages that quote, a check that nothing moved."""
