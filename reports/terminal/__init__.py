"""What the commands print: progress, and one screen of text or JSON at the end."""
