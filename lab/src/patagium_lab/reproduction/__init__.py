"""The paper's experiment, as published and corrected."""
