"""The screens of participants in viser: trials, the looks before them, and the cards between them."""
