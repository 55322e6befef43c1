"""Wings and flights that were measured, and constants found from them."""
