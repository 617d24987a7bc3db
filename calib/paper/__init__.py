"""The paper's experiments: its tables, figures and adaptation, with our figures for comparison."""
