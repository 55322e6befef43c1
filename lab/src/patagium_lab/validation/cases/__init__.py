"""Cases of the validation, one module each; a new case is named in `validation.plan.CASES`."""
