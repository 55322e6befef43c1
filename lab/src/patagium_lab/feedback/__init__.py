"""Study of feedback along an orbit: largest delay, slowest rate, region of attraction."""
