//! Integration tests of the whole project, one binary; one module per promise.
