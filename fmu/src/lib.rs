//! FMI 2.0 co-simulation around the estimators of `wheelstate`.
