//! What one kind of trial is made of: machine, plan, noise, injected effects, and the description that is fitted.
//!
//! Place in the flow: [`crate::suite`] lists the scenarios; [`crate::trial`] makes one for a seed. The seed draws
//! machine, plan and noise, so no two trials of a scenario share any of them. SI.

use abbe_geometry::error_function::FunctionKind;
use abbe_identify::OrderChoice;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::{Correlated, InstrumentConfig, Outliers};
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::recipe::LineSelection;
use abbe_virtual_machine::plan::{PlanRecipe, presets};
use abbe_virtual_machine::{Axis, MachineTruth, SimulationConfig, SimulationError, TruthRecipe};

use crate::error::TrialError;
use crate::template::Choices;

/// What a trial is to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// One effect that has a name.
    Single,
    /// Two effects at once.
    Pair,
    /// Three effects at once.
    Triple,
    /// One effect on a machine of another kind, or in few readings.
    Elsewhere,
    /// A smooth effect that no candidate describes.
    Undescribed,
    /// An effect that the plan cannot tell from the machine's errors: to be reported as such, not claimed.
    Aliased,
    /// No effect.
    Clean,
    /// No effect, but something else is wrong: to be called what it is, not an effect.
    Adverse,
}

impl Family {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Family::Single => "single",
            Family::Pair => "pair",
            Family::Triple => "triple",
            Family::Elsewhere => "elsewhere",
            Family::Undescribed => "undescribed",
            Family::Aliased => "aliased",
            Family::Clean => "clean",
            Family::Adverse => "adverse",
        }
    }
}

/// Which preset plan is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PlanKind {
    /// Five stations, drawn lines, three offsets, both directions.
    CaseLike,
    /// The same with another table load for every line.
    LoadByLine,
    /// A quarter of its lines.
    Few,
    /// Four stations, one offset, all lines in +X, in order.
    A,
    /// As A with three offsets and both directions.
    B,
    /// As B with six stations and lines in random order.
    C,
}

/// Which machine is measured; the seed draws its errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum MachineKind {
    /// The shipped bridge, 800 × 600 × 600 mm.
    Bridge,
    /// Bed → Y → X → Z, 700 × 1000 × 600 mm.
    Fyxz,
    /// Moving table, 500 × 400 × 300 mm.
    MovingTable,
    /// Gantry, 4 × 2 × 1 m, with readings below zero.
    Gantry,
    /// Bridge of a third of the shipped one.
    SmallBridge,
}

impl MachineKind {
    fn truth(self, recipe: &TruthRecipe) -> Result<MachineTruth, SimulationError> {
        const XYZ: [&[Axis]; 2] = [&[Axis::X, Axis::Y, Axis::Z], &[]];
        match self {
            MachineKind::Bridge => recipe.bridge_xyz(),
            MachineKind::Fyxz => recipe.fyxz(),
            MachineKind::MovingTable => recipe.moving_table(),
            MachineKind::Gantry => recipe.machine("gantry", [[-2.0, 2.0], [-1.0, 1.0], [-1.0, 0.0]], XYZ, Axis::Y),
            MachineKind::SmallBridge => {
                recipe.machine("small bridge", [[0.0, 0.3], [0.0, 0.2], [0.0, 0.2]], XYZ, Axis::Y)
            }
        }
    }
}

/// What the level of an effect is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SizedBy {
    /// The factor by which the effect alone raises the verification error.
    Error,
    /// The factor on the template's size, for effects that spoil readings more than the model.
    Size,
}

/// One kind of trial.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Name, unique in a suite.
    pub name: String,
    /// What it is to show.
    pub family: Family,
    /// Templates of the injected effects, see [`crate::template`].
    pub injected: Vec<&'static str>,
    /// How large the effects are, see [`Self::sized_by`]; empty where none is injected.
    pub levels: Vec<f64>,
    /// What a level is.
    pub sized_by: SizedBy,
    /// The machine.
    pub machine: MachineKind,
    /// The plan.
    pub plan: PlanKind,
    /// Roughness of the machine.
    pub roughness: Roughness,
    /// Kind of the error functions in the description.
    pub kind: FunctionKind,
    /// Whether their order is left to the data.
    pub order: OrderChoice,
    /// Errors that the description holds at zero, because the plan cannot see them.
    pub held_zero: &'static [&'static str],
    /// True noise over declared noise.
    pub noise: f64,
    /// Spoilt readings.
    pub outliers: Option<Outliers>,
    /// Noise that readings share with those before them.
    pub correlated: Option<Correlated>,
}

impl Scenario {
    /// A typical machine measured and described as the shipped one, without any effect.
    pub fn plain(name: impl Into<String>, family: Family) -> Scenario {
        Scenario {
            name: name.into(),
            family,
            injected: Vec::new(),
            levels: Vec::new(),
            sized_by: SizedBy::Error,
            machine: MachineKind::Bridge,
            plan: PlanKind::CaseLike,
            roughness: Roughness::TYPICAL,
            kind: FunctionKind::BSpline { intervals: 9 },
            order: OrderChoice::Evidence,
            held_zero: &[],
            noise: 1.0,
            outliers: None,
            correlated: None,
        }
    }

    /// The simulation of one seed without any effect.
    ///
    /// # Errors
    /// The simulator refuses a setting.
    pub fn clean_config(&self, seed: u64) -> Result<SimulationConfig, TrialError> {
        let recipe = TruthRecipe { seed, roughness: self.roughness, ..TruthRecipe::default() };
        let machine = self.machine.truth(&recipe)?;
        let plan = match self.plan {
            PlanKind::Few => {
                PlanRecipe { selection: LineSelection::Drawn(9), ..presets::case_like(machine.stroke_m, seed) }
            }
            PlanKind::CaseLike => presets::case_like(machine.stroke_m, seed),
            PlanKind::LoadByLine => PlanRecipe { load_by_line: true, ..presets::case_like(machine.stroke_m, seed) },
            PlanKind::A => presets::plan_a(machine.stroke_m, seed),
            PlanKind::B => presets::plan_b(machine.stroke_m, seed),
            PlanKind::C => presets::plan_c(machine.stroke_m, seed),
        };
        let mut instrument =
            InstrumentConfig { outliers: self.outliers, correlated: self.correlated, ..declared_instrument() };
        instrument.range.constant_m *= self.noise;
        instrument.range.per_metre *= self.noise;
        instrument.repeatability_m = instrument.repeatability_m.map(|value| value * self.noise);
        Ok(SimulationConfig {
            seed,
            plan: plan.build()?,
            machine,
            instrument,
            environment: EnvironmentConfig::workshop(),
            effects: Vec::new(),
        })
    }

    /// Texts of the injected effects for one seed, each at its own size.
    ///
    /// # Errors
    /// A template cannot be filled in.
    pub fn texts(&self, config: &SimulationConfig, sizes: &[f64]) -> Result<Vec<String>, TrialError> {
        let choices = choices(config);
        self.injected.iter().zip(sizes).map(|(template, size)| choices.fill(template, *size)).collect()
    }
}

/// Noise that every description declares.
pub fn declared_instrument() -> InstrumentConfig {
    InstrumentConfig::LASER_TRACER
}

/// What the seed of a simulation chooses in templates.
pub fn choices(config: &SimulationConfig) -> Choices {
    let lines: usize = config.plan.stations.iter().map(|station| station.lines.len()).sum();
    Choices::new(config.seed, u32::try_from(lines).unwrap_or(u32::MAX))
}

/// The same simulation with effects from their texts.
///
/// # Errors
/// A text describes no effect.
pub fn with_effects(config: &SimulationConfig, texts: &[String]) -> Result<SimulationConfig, TrialError> {
    let mut out = config.clone();
    for text in texts {
        out.effects.push(from_text(text)?);
    }
    Ok(out)
}
