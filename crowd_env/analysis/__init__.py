"""What results say: clogging, exit times, pressure."""
