"""Import of logs of other programs: survey, findings, one time base, one file."""
