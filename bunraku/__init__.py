"""Move a full-body figure live with your hands: touch, pen, hands in the air, walking fingers."""

__version__ = "0.1.0"
