"""Other ways to the same equations, as oracles and as rivals in the bench."""
