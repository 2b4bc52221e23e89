//! The `model!` macro. It reads one statement at a time and writes one call of the builder per
//! statement; every expression of the model file becomes the body of one function, generic over the
//! number type, in a unit struct of its own.
//!
//! State carried from statement to statement, in this order:
//!
//! ```text
//! params    (name {type} len)      what priors, means, kernels, densities and rows can see
//! rows      (name)                 what only rows can see: a field, a labelled vector, a predictor
//! lets      (name (row) {expr})    recomputed from the above in each row
//! columns   (name {type})          numeric columns, the fields of `row`
//! observes  calls of the builder for `observe`, made last, when every effect is known
//! out       calls of the builder for the rest
//! ```

/// Declares a model: see `models/erp.rs` for a whole one, and ARCHITECTURE.md for the grammar.
#[macro_export]
macro_rules! model {
    ($(#[doc = $doc:literal])* model $M:ident; $($rest:tt)*) => {
        $(#[doc = $doc])* #[derive(Clone, Copy, Debug)] #[allow(unreachable_pub, missing_docs)] pub struct $M;
        impl $crate::model::Declare for $M {
            fn name(&self) -> &'static str { stringify!($M) }
            fn doc(&self) -> &'static str { concat!($($doc, "\n"),*) }
            #[allow(unused, unreachable_pub, non_snake_case, clippy::all, clippy::pedantic)]
            fn declare(&self, b: &mut $crate::model::expansion::Builder<'_>) -> Result<(), $crate::model::ModelError> {
                $crate::statement!{ b [] [] [] [] [] [] $($rest)* }
                Ok(())
            }
        }
    };
    ($($other:tt)*) => { compile_error!{"a model begins with `model NAME;`"} };
}

#[macro_export]
#[doc(hidden)]
macro_rules! statement {
    // param sigma [ms] ~ HalfNormal(5.0);   param w(3) ~ Normal(0.0, 1.0);   param b(group) [ms] ~ Normal(0.0, tau);
    ($b:ident [$($P:tt)*] $R:tt $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* param $p:ident $([$($u:tt)+])? ~ $d:expr; $($rest:tt)*) => {
        $crate::statement!{ $b [$($P)* ($p {D} 1)] $R $L $C $V [$($o)* $crate::param!{ $b [$($P)*] $p [$($($u)+)?] [$($doc)*] One, $d }] $($rest)* } };
    ($b:ident [$($P:tt)*] $R:tt $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* param $p:ident ($n:literal) $([$($u:tt)+])? ~ $d:expr; $($rest:tt)*) => {
        $crate::statement!{ $b [$($P)* ($p {[D; $n]} $n)] $R $L $C $V [$($o)* $crate::vector!{ $b [$($P)*] $p [$($($u)+)?] [$($doc)*] $n, $d }] $($rest)* } };
    ($b:ident $P:tt [$($R:tt)*] $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* param $p:ident ($each:ident) $([$($u:tt)+])? ~ $d:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P [$($R)* ($p)] $L $C $V [$($o)* $crate::param!{ $b $P $p ($each) [$($($u)+)?] [$($doc)*] Each(stringify!($each)), $d }] $($rest)* } };

    // field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) + … where { m [ms] ~ Flat; … }
    ($b:ident $P:tt [$($R:tt)*] $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* field $f:ident ($x:ident) $([$($u:tt)+])? $(in $lo:literal..$hi:literal)? = $mean:tt
        $(+ $amp:tt * gp($kernel:expr, K = $K:literal))+ where { $($h:ident $([$($hu:tt)+])? ~ $hd:expr;)* } $($rest:tt)*) => {
        $crate::statement!{ $b $P [$($R)* ($f)] $L $C $V [$($o)*
            $b.field($crate::decl!($f ($x) [$($($u)+)?] [$($doc)*] $mean $(+ $amp * gp($kernel, K = $K))+), $crate::range!($($lo, $hi)?));
            $crate::field!{ $b $P [$(($h [$($($hu)+)?] {$hd}))*] [$($h)*] $mean [$(($amp {$kernel} $K))+] }
        ] $($rest)* } };

    // let eta(row) = linear(row.a, row.b; beta);
    ($b:ident $P:tt [$($R:tt)*] $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* let $g:ident ($x:ident) $([$($u:tt)+])? = linear($($r:ident . $c:ident),+ ; $beta:ident); $($rest:tt)*) => {
        $crate::statement!{ $b $P [$($R)* ($g)] $L $C $V [$($o)* $b.linear($crate::decl!($g ($x) [$($($u)+)?] [$($doc)*] linear($($r.$c),+; $beta)), &[$(stringify!($c)),+], stringify!($beta));] $($rest)* } };
    // let erp_s2(x) [ms] in 0.0..285.0 = f(tau_out(x), row.force_g);
    ($b:ident $P:tt $R:tt [$($L:tt)*] $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* let $g:ident ($x:ident) $([$($u:tt)+])? $(in $lo:literal..$hi:literal)? = $e:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R [$($L)* ($g ($x) {$e})] $C $V [$($o)* $crate::value!{ $b $P $R [$($L)*] $g ($x) [$($($u)+)?] [$($doc)*] [$($lo, $hi)?] $e }] $($rest)* } };

    // column force_g [g];   column x(30);
    ($b:ident $P:tt $R:tt $L:tt [$($C:tt)*] $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* column $c:ident $([$($u:tt)+])?; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L [$($C)* ($c {f64})] $V [$($o)* $b.column($crate::decl!($c [$($($u)+)?] [$($doc)*]));] $($rest)* } };
    ($b:ident $P:tt $R:tt $L:tt [$($C:tt)*] $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* column $c:ident ($n:literal) $([$($u:tt)+])?; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L [$($C)* ($c {[f64; $n]})] $V [$($o)* $b.column($crate::decl!($c ($n) [$($($u)+)?] [$($doc)*]));] $($rest)* } };

    // observe s1s2(x): Bracket [ms] ~ TopHat(erp_s2(x));   observe ratio(row): Number from (row.b / row.a) ~ Normal(mean(row), noise);
    ($b:ident $P:tt $R:tt $L:tt $C:tt [$($V:tt)*] $o:tt $(#[doc = $doc:literal])* observe $y:ident ($x:ident) : $Y:ident $([$($u:tt)+])? $(from ($from:expr))? ~ $lik:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L $C [$($V)* $crate::observe!{ $b $P $R $L $y ($x) $Y [$($($u)+)?] [$($doc)*] [$($from)?] $lik }] $o $($rest)* } };

    // effect force on erp_s2, erp_s3 [ms] = linear(row.force_g) ~ Normal(0.0, 10.0);
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* effect $e:ident on $($t:ident),+ $([$($u:tt)+])? = linear($($r:ident . $c:ident),+) ~ $d:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L $C $V [$($o)* { $crate::prior!{ $P $d }
            $b.effect::<Here, { SCOPE.size() }, { SCOPE.width() + 1 }>(Here, $crate::decl!($e [$($($u)+)?] [$($doc)*] on $($t),+ = linear($($r.$c),+) ~ $d), stringify!($d), &[$(stringify!($t)),+], &[$(stringify!($c)),+], &SCOPE)?; }] $($rest)* } };

    // effect force on erp_s2 [ms] = scaled(row.force_g, 15.0, 5.0) ~ Normal(0.0, 10.0);   …
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* effect $e:ident on $($t:ident),+ $([$($u:tt)+])? = $form:ident ($($arg:tt)*) ~ $d:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L $C $V [$($o)* { $crate::prior!{ $P $d }
            $b.formed_effect::<Here, { SCOPE.size() }, { SCOPE.width() + 1 }>(Here, $crate::decl!($e [$($($u)+)?] [$($doc)*] on $($t),+ = $form($($arg)*) ~ $d), stringify!($d), &[$(stringify!($t)),+], $crate::form!($form $($arg)*), &SCOPE)?; }] $($rest)* } };

    // density banana = my_density(a, b);   density returns(data) = garch(mu, alpha, data.y);
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt [$($o:tt)*] $(#[doc = $doc:literal])* density $n:ident $(($data:ident))? = $e:expr; $($rest:tt)*) => {
        $crate::statement!{ $b $P $R $L $C $V [$($o)* $crate::density!{ $b $P $n [$($data)?] [$($doc)*] $e }] $($rest)* } };

    // the end
    ($b:ident [$(($p:ident $pt:tt $pn:tt))*] [$(($r:ident))*] [$(($g:ident $gx:tt $ge:tt))*] [$(($c:ident {$ct:ty}))*] [$($V:tt)*] [$($o:tt)*]) => {
        #[allow(non_camel_case_types)] enum Names { $($p,)* $($r,)* $($g,)* } // a name is declared once
        #[derive(Debug)] pub struct Row { $(pub $c: $ct),* }
        pub struct Data<'a> { $(pub $c: &'a [$ct],)* rows: std::marker::PhantomData<&'a ()> }
        impl $crate::model::expansion::Columns for Row {
            type Data<'a> = Data<'a>;
            fn names() -> Vec<(&'static str, Vec<String>)> { vec![$((stringify!($c), <$ct as $crate::model::expansion::Column>::names(stringify!($c)))),*] }
            fn read<E>(column: &mut dyn FnMut(&str) -> Result<f64, E>) -> Result<Self, E> {
                Ok(Row { $($c: $crate::model::expansion::read_column(stringify!($c), column)?),* })
            }
            fn data(cells: &[Vec<f64>]) -> Data<'_> {
                let mut cells = cells.iter();
                Data { $($c: cells.next().map_or(&[], |c| $crate::model::expansion::Column::rows(c)),)* rows: std::marker::PhantomData }
            }
        }
        $($o)*
        $($V)*
    };

    // mistakes
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* param $($t:tt)*) => { $crate::mistake!{ "expected `param NAME [unit] ~ PRIOR;`, `param NAME(label_column) [unit] ~ PRIOR;`, `param NAME(3) ~ PRIOR;`, `param NAME(3) ~ Dirichlet(1.0);` or `param NAME(3) ~ Ordered(Normal(0.0, 1.0));`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* field $($t:tt)*) => { $crate::mistake!{ "expected `field NAME(x) [unit] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where { m [ms] ~ Flat; … }`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* let $($t:tt)*) => { $crate::mistake!{ "expected `let NAME(x) [unit] = EXPRESSION;`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* column $($t:tt)*) => { $crate::mistake!{ "expected `column NAME [unit];` or `column NAME(3);`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* observe $($t:tt)*) => { $crate::mistake!{ "expected `observe NAME(x): Bracket [unit] ~ LIKELIHOOD;` or `observe NAME(row): Number [unit] from (row.a / row.b) ~ LIKELIHOOD;`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* effect $($t:tt)*) => { $crate::mistake!{ "expected `effect NAME on LET, LET [unit] = linear(row.COLUMN) ~ PRIOR;`, or `scaled`, `smooth`, `above`, `logistic`, `group`, `family`, `all`, `surface`, `path` in place of `linear`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* density $($t:tt)*) => { $crate::mistake!{ "expected `density NAME(data) = f(PARAMETER, data.COLUMN);` or `density NAME = f(PARAMETER);`" $($t)* } };
    ($b:ident $P:tt $R:tt $L:tt $C:tt $V:tt $o:tt $(#[doc = $doc:literal])* $first:tt $($t:tt)*) => { $crate::mistake!{ "a statement begins with `param`, `field`, `let`, `column`, `observe`, `effect` or `density`" $first $($t)* } };
}

/// The right-hand side of an effect.
#[macro_export]
#[doc(hidden)]
macro_rules! form {
    (scaled $r:ident . $c:ident, $centre:expr, $scale:expr) => { $crate::model::expansion::Form::Scaled { column: stringify!($c).into(), centre: f64::from($centre), scale: f64::from($scale) } };
    (smooth $r:ident . $c:ident, $low:expr, $high:expr, $degree:expr) => { $crate::model::expansion::Form::Smooth { column: stringify!($c).into(), low: f64::from($low), high: f64::from($high), degree: $degree } };
    (above $r:ident . $c:ident, $threshold:expr) => { $crate::model::expansion::Form::Above { column: stringify!($c).into(), threshold: f64::from($threshold) } };
    (logistic $r:ident . $c:ident, $centre:expr, $scale:expr) => { $crate::model::expansion::Form::Logistic { column: stringify!($c).into(), centre: f64::from($centre), scale: f64::from($scale) } };
    (group $r:ident . $c:ident) => { $crate::model::expansion::Form::Group { column: stringify!($c).into() } };
    (family $r:ident . $c:ident) => { $crate::model::expansion::Form::Family { column: stringify!($c).into() } };
    (all $r:ident) => { $crate::model::expansion::Form::All };
    (surface $r:ident, $modes:literal, $lengthscale:expr) => { $crate::model::expansion::Form::Surface { modes: $modes, lengthscale: f64::from($lengthscale) } };
    (path $r:ident, $modes:literal, $lengthscale:expr) => { $crate::model::expansion::Form::Path { modes: $modes, lengthscale: f64::from($lengthscale) } };
    ($($other:tt)*) => { { $crate::mistake!{ "expected `linear(row.a, row.b)`, `scaled(row.a, CENTRE, SCALE)`, `smooth(row.a, LOW, HIGH, DEGREE)`, `above(row.a, THRESHOLD)`, `logistic(row.a, CENTRE, SCALE)`, `group(row.a)`, `family(row.a)`, `all(row)`, `surface(row, MODES, LENGTHSCALE)` or `path(row, MODES, LENGTHSCALE)`" $($other)* } $crate::model::expansion::Form::All } };
}

/// A message (its span is the whole `model!`), and an error at the place: `no rules expected` points
/// at the user's token.
#[macro_export]
#[doc(hidden)]
macro_rules! mistake { ($message:literal $($t:tt)*) => { compile_error!{$message} $crate::here!{ $($t)* } } }

#[macro_export]
#[doc(hidden)]
macro_rules! here {
    () => {};
}

#[macro_export]
#[doc(hidden)]
macro_rules! decl { ($name:ident $(($over:tt))? [$($u:tt)*] [$($doc:literal)*] $($text:tt)*) => {
    $crate::model::expansion::Decl { name: stringify!($name), over: concat!($(stringify!($over))?), unit: $crate::unit!($($u)*), text: stringify!($($text)*), doc: concat!($($doc, "\n"),*) }
} }

/// A declared unit: one of these, or one over another.
#[macro_export]
#[doc(hidden)]
macro_rules! unit {
    () => { "" };
    (1) => { "1" };
    (%) => { "%" };
    (ms) => { "ms" };
    (ms2) => { "ms2" };
    (s) => { "s" };
    (min) => { "min" };
    (mm) => { "mm" };
    (mm2) => { "mm2" };
    (cm) => { "cm" };
    (m) => { "m" };
    (Hz) => { "Hz" };
    (mV) => { "mV" };
    (mA) => { "mA" };
    (g) => { "g" };
    (ohm) => { "ohm" };
    (deg) => { "deg" };
    (degC) => { "degC" };
    ($a:tt / $b:tt) => { { let _ = ($crate::unit!($a), $crate::unit!($b)); concat!(stringify!($a), "/", stringify!($b)) } };
    ($($other:tt)*) => { { $crate::mistake!{ "unknown unit: expected one of 1, %, ms, s, min, mm, cm, m, ms2, mm2, Hz, mV, mA, g, ohm, deg, degC, or one over another such as m/s" $($other)* } "" } };
}

#[macro_export]
#[doc(hidden)]
macro_rules! range {
    () => {
        None
    };
    ($lo:literal, $hi:literal) => {
        Some((f64::from($lo), f64::from($hi))) // `1..30` too
    };
}

/// `struct Here` and `const SCOPE`: who can be seen, and whom `$e` mentions.
#[macro_export]
#[doc(hidden)]
macro_rules! scope { ([$(($p:ident {$t:ty} $n:expr))*] $e:expr) => {
    #[derive(Clone, Copy, Debug)] struct Here;
    const SCOPE: $crate::model::expansion::Scope = $crate::model::expansion::Scope {
        names: &[$(stringify!($p)),*], lens: &[$($n),*], lets: 0,
        mask: $crate::model::expansion::uses(stringify!($e), &[$(stringify!($p)),*]),
    };
} }

#[macro_export]
#[doc(hidden)]
macro_rules! prior { ([$(($p:ident {$t:ty} $n:expr))*] $d:expr) => {
    $crate::scope!{ [$(($p {$t} $n))*] $d }
    impl $crate::model::expansion::PriorFn for Here {
        #[inline] fn dist<D: $crate::num::Real>(s: &[D]) -> impl $crate::dist::Dist<D> + use<D> { let mut s = s.iter().copied(); $(let $p: $t = $crate::model::expansion::Take::take(&mut s);)* $d }
    }
} }

#[macro_export]
#[doc(hidden)]
macro_rules! scalar { ([$(($p:ident {$t:ty} $n:expr))*] $e:expr) => {
    $crate::scope!{ [$(($p {$t} $n))*] $e }
    impl $crate::model::expansion::ScalarFn for Here {
        #[inline] fn value<D: $crate::num::Real>(s: &[D]) -> D { let mut s = s.iter().copied(); $(let $p: $t = $crate::model::expansion::Take::take(&mut s);)* $crate::model::expansion::lift($e) }
    }
} }

#[macro_export]
#[doc(hidden)]
macro_rules! kernel { ([$(($p:ident {$t:ty} $n:expr))*] $e:expr) => {
    $crate::scope!{ [$(($p {$t} $n))*] $e }
    impl $crate::model::expansion::KernelFn for Here {
        #[inline(always)] fn kernel<D: $crate::num::Real>(s: &[D]) -> impl $crate::field::Kernel<D> + use<D> { let mut s = s.iter().copied(); $(let $p: $t = $crate::model::expansion::Take::take(&mut s);)* $e }
    }
} }

#[macro_export]
#[doc(hidden)]
macro_rules! density {
    ($b:ident $P:tt $n:ident [] [$($doc:literal)*] $e:expr) => { $crate::density!{ @ $b $P $n [data] [$($doc)*] $e; false } };
    ($b:ident $P:tt $n:ident [$data:ident] [$($doc:literal)*] $e:expr) => { $crate::density!{ @ $b $P $n [$data] [$($doc)*] $e; true } };
    (@ $b:ident [$(($p:ident {$t:ty} $m:expr))*] $n:ident [$data:ident] [$($doc:literal)*] $e:expr; $reads:literal) => { {
        $crate::scope!{ [$(($p {$t} $m))*] $e }
        impl $crate::model::expansion::DensityFn for Here {
            type Columns = Row;
            #[inline] fn terms<D: $crate::num::Real>(s: &[D], $data: &Data<'_>) -> impl $crate::model::expansion::Terms<D> + use<D> { let mut s = s.iter().copied(); $(let $p: $t = $crate::model::expansion::Take::take(&mut s);)* $e }
        }
        $b.density::<Here, { SCOPE.size() }, { SCOPE.width() }>(Here, $crate::decl!($n [] [$($doc)*] $e), &SCOPE, $reads.then_some(stringify!($data)))?;
    } };
}

#[macro_export]
#[doc(hidden)]
macro_rules! param { ($b:ident $S:tt $p:ident $(($over:tt))? [$($u:tt)*] [$($doc:literal)*] $len:ident $(($n:expr))?, $d:expr) => { {
    $crate::prior!{ $S $d }
    $b.param::<Here, { SCOPE.size() }, { SCOPE.width() + 1 }>(Here, $crate::decl!($p $(($over))? [$($u)*] [$($doc)*] $d), $crate::model::expansion::Len::$len $(($n))?, &SCOPE)?;
} } }

#[macro_export]
#[doc(hidden)]
macro_rules! vector { ($b:ident [$(($q:ident {$t:ty} $m:expr))*] $p:ident [$($u:tt)*] [$($doc:literal)*] $n:literal, $d:expr) => { {
    $crate::scope!{ [$(($q {$t} $m))*] $d }
    impl $crate::model::expansion::VectorFn for Here {
        #[inline] fn prior<D: $crate::num::Real>(s: &[D]) -> impl $crate::dist::Vector<D> + use<D> { let mut s = s.iter().copied(); $(let $q: $t = $crate::model::expansion::Take::take(&mut s);)* $crate::dist::vector::<D, _, _>($d) }
    }
    $b.vector::<Here, { SCOPE.size() }, { SCOPE.width() + 1 }, { SCOPE.width() + 2 }>(Here, $crate::decl!($p ($n) [$($u)*] [$($doc)*] $d), $n, &SCOPE)?;
} } }

#[macro_export]
#[doc(hidden)]
macro_rules! field {
    // hyperparameters, each seeing the earlier ones
    ($b:ident [$($S:tt)*] [($h:ident $u:tt {$d:expr}) $($more:tt)*] [$($all:ident)*] $($rest:tt)*) => {
        $crate::param!{ $b [$($S)*] $h $u [] One, $d }
        $crate::field!{ $b [$($S)* ($h {D} 1)] [$($more)*] [$($all)*] $($rest)* } };
    ($b:ident $S:tt [] [$($h:ident)*] $mean:tt [$(($amp:tt {$kernel:expr} $K:literal))+]) => {
        let mean = $crate::field!{ @scalar $b $S $mean };
        let terms = $crate::field!{ @terms $b $S $(($amp {$kernel} $K))+ };
        $b.field_end(&[$(stringify!($h)),*], stringify!($mean), mean, terms)?; };
    (@scalar $b:ident $S:tt $e:expr) => { { $crate::scalar!{ $S $e } $b.scalar::<Here, { SCOPE.size() }, { SCOPE.width() }>(Here, &SCOPE) } };
    (@terms $b:ident $S:tt $($term:tt)+) => { vec![$($crate::field!{ @term $b $S $term }),+] };
    (@term $b:ident $S:tt ($amp:tt {$kernel:expr} $K:literal)) => { {
        let amplitude = $crate::field!{ @scalar $b $S $amp };
        $crate::kernel!{ $S $kernel }
        $b.term::<Here, { SCOPE.size() }, { SCOPE.width() }>(amplitude, Here, $K, &SCOPE) } };
}

/// The scope of a row, as `const SCOPE`, and what binds its scalars to their names, as `scalars!`.
#[macro_export]
#[doc(hidden)]
macro_rules! row_scope { ([$(($p:ident {$t:ty} $n:expr))*] [$(($r:ident))*] [$(($g:ident $gx:tt {$e:expr}))*] $text:expr) => {
    const NAMES: &[&str] = &[$(stringify!($p),)* $(stringify!($r),)* $(stringify!($g),)*];
    const LETS: &[&str] = &[$(stringify!($e)),*];
    const SCOPE: $crate::model::expansion::Scope = $crate::model::expansion::Scope {
        names: NAMES, lens: &[$($n,)* $($crate::model::expansion::one(stringify!($r)),)* $($crate::model::expansion::one(stringify!($g)),)*], lets: LETS.len(),
        mask: $crate::model::expansion::uses_through($text, NAMES, NAMES.len() - LETS.len(), LETS),
    };
    #[derive(Debug)] struct Here;
} }

/// Binds the names of a row's scope; a `let` is evaluated only if it is mentioned.
#[macro_export]
#[doc(hidden)]
macro_rules! bind { ($s:ident $row:ident [$(($p:ident {$t:ty} $n:expr))*] [$(($r:ident))*] [$(($g:ident ($gx:ident) {$e:expr}))*]) => {
    let mut s = $s.iter().copied();
    $( let $p: $t = $crate::model::expansion::Take::take(&mut s); )*
    $( let $r = { let v: D = $crate::model::expansion::Take::take(&mut s); move |_: &Row| v }; )*
    $( let $g = { let mut v: D = $crate::model::expansion::Take::take(&mut s); if const { SCOPE.has(stringify!($g)) } { let $gx = $row; v += $crate::model::expansion::lift::<D>($e); } move |_: &Row| v }; )*
} }

#[macro_export]
#[doc(hidden)]
macro_rules! value { ($b:ident $P:tt $R:tt $L:tt $g:ident ($x:ident) [$($u:tt)*] [$($doc:literal)*] [$($lo:literal, $hi:literal)?] $e:expr) => { {
    $crate::row_scope!{ $P $R $L stringify!($e) }
    impl $crate::model::expansion::LetFn for Here {
        type Columns = Row;
        #[inline] fn value<D: $crate::num::Real>(s: &[D], row: &Row) -> D {
            $crate::bind!{ s row $P $R $L }
            let $x = row;
            $crate::model::expansion::lift($e)
        }
    }
    $b.value::<Here, { SCOPE.size() }>(Here, $crate::decl!($g ($x) [$($u)*] [$($doc)*] $e), $crate::range!($($lo, $hi)?), &SCOPE, $crate::model::expansion::mentions_columns(stringify!($e), stringify!($x)));
} } }

#[macro_export]
#[doc(hidden)]
macro_rules! observe { ($b:ident $P:tt $R:tt $L:tt $y:ident ($x:ident) $Y:ident [$($u:tt)*] [$($doc:literal)*] [$($from:expr)?] $lik:expr) => { {
    $crate::row_scope!{ $P $R $L stringify!($lik) }
    impl $crate::model::expansion::RowFn for Here {
        type Columns = Row;
        type Y = $Y;
        const SCOPE: $crate::model::expansion::Scope = SCOPE;
        #[inline(always)] fn likelihood<D: $crate::num::Real>(s: &[D], row: &Row) -> impl $crate::likelihood::Likelihood<D, $Y> + use<D> {
            $crate::bind!{ s row $P $R $L }
            let $x = row;
            $lik
        }
        $(
        const FROM: Option<&'static str> = Some(stringify!($from));
        fn measured($x: &Row) -> Option<$Y> { Some($from) }
        )?
    }
    $b.observe::<Here, { SCOPE.size() }, { SCOPE.width() }>(Here, $crate::decl!($y ($x) [$($u)*] [$($doc)*] $Y $(from ($from))? ~ $lik), &SCOPE)?;
} } }
