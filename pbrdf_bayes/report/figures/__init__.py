"""Pictures of records: functions that take an Axes and return it, and pages' SVG made of them."""
