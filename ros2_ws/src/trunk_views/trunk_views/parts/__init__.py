"""Parts of pages, one set for live, report and lab; and how a page that is one file holds them."""
