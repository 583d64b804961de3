//! Offline tool of Relume: scene -> response -> tiles -> field file.
