"""Between capture and fit: what is likely to go wrong with these photos, and how long it will take."""
