"""Files: written whole or not at all, tables as spreadsheets write them, and what a file really is."""
