"""The study of [WM] section 6 repeated: its estimators, table and conclusions beside ours."""
