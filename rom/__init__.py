"""Physics and signals: records in, reduced-order model out, and its fast simulation."""
