"""The command ``crowd-env``."""
