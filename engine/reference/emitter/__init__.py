"""The paper's training of the light."""
