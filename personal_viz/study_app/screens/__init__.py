"""What a participant sees and presses, from the first page to the last."""
