"""From results to what people look at: pictures, tables, run folders."""
