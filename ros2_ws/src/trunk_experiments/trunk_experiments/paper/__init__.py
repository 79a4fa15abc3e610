"""The paper: its figures reproduced, its claims judged, its misprints shown."""
