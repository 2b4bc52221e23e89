use eplat::prelude::*;

model! {
    model Mistaken;

    param decay [1] ~ Beta(1.0, 1.0);
    let rate(row) = log(decay) + expp(decay);
    observe y(row): Number ~ Normal(rate(row), 1.0);
}
