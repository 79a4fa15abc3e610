"""The lab: its runs in Node and in browsers, compared with the project's own."""
