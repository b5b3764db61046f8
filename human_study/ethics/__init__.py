"""What participants and ethics boards read, written from the study file."""
