"""Thin bridges to learning libraries, one file each; import the one you need."""
