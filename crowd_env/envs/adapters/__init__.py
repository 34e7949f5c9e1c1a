"""Thin bridges to learning libraries, one folder each; import the one you need."""
