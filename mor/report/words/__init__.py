"""Words of reports: what terms, columns and codes mean, and how they are called in German."""
