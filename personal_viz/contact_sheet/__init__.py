"""One picture of a home: its storeys from above, views of rooms, and its objects."""
