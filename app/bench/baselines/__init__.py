"""Simpler methods that the benchmarks hold ours against; nothing else imports them."""
