"""Best topology of a modular aerial manipulator for a task, with an exact audit of every airflow clearance."""
