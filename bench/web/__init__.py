"""HTTP interface of a station: the API, its pages, and who may do what."""
