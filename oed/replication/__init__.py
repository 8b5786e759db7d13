"""The study of [WM] section 6 repeated, and fits in time beside those of FRFs."""
