//! The matrices that are stored, in whole or in part.

use super::stretches::InStretches;
use super::{Estimator, ExchangeMatrix, HemisphereRows, Transport};
use crate::settings::Method;
use serde::{Deserialize, Serialize};

/// A matrix of form factors that is stored, in whole or in part.
#[derive(Serialize, Deserialize)]
pub(crate) enum Matrix {
    Hemisphere(HemisphereRows),
    Pairs(ExchangeMatrix),
}

impl Matrix {
    pub(crate) fn transport(&self) -> &dyn Transport {
        match self {
            Matrix::Hemisphere(rows) => rows,
            Matrix::Pairs(exchanges) => exchanges,
        }
    }

    /// Memory that it takes so far.
    pub(crate) fn bytes(&self) -> u64 {
        match self {
            Matrix::Hemisphere(rows) => rows.bytes(),
            Matrix::Pairs(exchanges) => exchanges.bytes(),
        }
    }

    /// Whether an estimator may have begun it.
    pub(crate) fn is_possible(&self, of: &Estimator, method: Method) -> bool {
        match (self, method) {
            (Matrix::Hemisphere(rows), Method::Hemisphere) => rows.are_possible(of),
            (Matrix::Pairs(exchanges), Method::Pairs) => exchanges.is_possible(of),
            _ => false,
        }
    }

    fn parts(&mut self) -> &mut dyn InStretches {
        match self {
            Matrix::Hemisphere(rows) => rows,
            Matrix::Pairs(exchanges) => exchanges,
        }
    }
}

impl InStretches for Matrix {
    fn amounts(&self) -> [usize; 2] {
        match self {
            Matrix::Hemisphere(rows) => rows.amounts(),
            Matrix::Pairs(exchanges) => exchanges.amounts(),
        }
    }

    fn add(&mut self, of: &Estimator) {
        self.parts().add(of);
    }

    fn take_back(&mut self, done: usize) {
        self.parts().take_back(done);
    }
}
