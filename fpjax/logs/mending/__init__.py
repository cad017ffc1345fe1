"""From rows as they were written to one value a control period: stamps, gaps, numbers that are none."""
