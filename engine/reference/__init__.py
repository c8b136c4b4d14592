"""The paper's own methods as written, a yardstick beside ours: `process --solver reference` and the benchmarks alone use them."""
