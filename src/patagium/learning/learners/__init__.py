"""A network and a filter, with what is assumed of them."""
