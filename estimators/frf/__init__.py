"""FRFs that no model shapes, and what is known of their errors; records and FRFs as files."""
