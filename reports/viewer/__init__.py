"""The robot and its study in a browser, to turn, move and try out; needs the extra ``view``."""
