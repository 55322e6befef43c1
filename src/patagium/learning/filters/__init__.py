"""How one sample moves weights and their covariance."""
