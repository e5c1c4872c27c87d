"""Long trials (`make trials`) and what they draw: runs, scenes and faults with a known truth, by numpy alone."""
