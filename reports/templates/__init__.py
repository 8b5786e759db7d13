"""The report page: template and style."""
