"""The paper's own methods, as a yardstick beside ours: nothing of the pipeline depends on them."""
