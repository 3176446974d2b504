"""Re-establishing communication (Vandermeulen, Groß & Kolling): scenario, study, scores, figures."""
