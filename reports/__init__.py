"""What a person types and reads: the command line, tables, figures, the report page."""
