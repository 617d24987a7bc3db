"""The paper's experiments: its tables, figures and adaptation, beside our figures."""
