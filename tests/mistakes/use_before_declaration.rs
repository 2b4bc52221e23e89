use eplat::prelude::*;

model! {
    model Mistaken;

    field f(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ InvGamma(1.0, 5.0);
        rho   [mm] ~ InvGamma(1.01, 64.0);
    }
    let erp(x) [ms] = f(x) * scale;
    param scale [1] ~ Normal(1.0, 0.1);
    observe s1s2(x): Bracket [ms] ~ TopHat(erp(x));
}
