"""The page that an engineer hands in: many evacuations of one plan or several, compared, with their limits."""
