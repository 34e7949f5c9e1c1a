"""What comes out of many evacuations: figures, tables and curves, and the folder that keeps them while they are made."""
