"""What a study costs its participants and what it stands: keys, kills, crowds, restarts."""
