"""Where the method breaks, and whether it knows: good sets made worse step by step."""
