"""The interactive viewer of a robot and its study; needs the extra ``view``."""
