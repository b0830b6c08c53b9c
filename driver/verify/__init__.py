"""Published cases of other codes and closed forms: solved, compared, put on a page."""
