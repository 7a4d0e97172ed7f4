//! One self-contained HTML page and one JSON document per run.
