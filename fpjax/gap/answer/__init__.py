"""Answer: from the decision to a Diagnosis."""
