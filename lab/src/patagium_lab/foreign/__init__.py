"""Foreign air: flights whose air other programs made, and what each learner makes of them."""
