//! Speed of the network: one prediction against `burn`'s own forward pass, and training against PyTorch.
//!
//! Place in the flow: `cargo bench -p abbe-residual-training`. Both start from 1000 random points of a simulated field.
//! `pytorch_training.py` gets tokens, targets and first parameters in a file and trains the same network with the same
//! batches' size, rate and number of epochs; it must begin with our loss and prints its time and last loss. The interpreter is
//! `ABBE_TORCH_PYTHON`, else `ABBE_PYTHON`, else `python3`; without torch the comparison says that it was not run.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)] // criterion's macros; a bench that cannot be prepared stops

use abbe_field::Samples;
use abbe_residual_net::network::forward::forward;
use abbe_residual_net::network::{Folded, NetworkConfig, Parameters, Token};
use abbe_residual_net::{ResidualMethod, ResidualModel, VERTICES};
use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
use abbe_residual_training::{
    Attention, Config, Device, Examples, Go, Method, Network, Optimiser, Training, View, train,
};
use burn::tensor::{Tensor, TensorData};
use criterion::{Criterion, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::io::Write;
use std::process::Command;
use std::time::Instant;

const POINTS: usize = 1000;
const EPOCHS: usize = 20;

fn field() -> Samples {
    SimulatedField::new(Character::Smooth, 1).measured(random_points_m(POINTS, 2), 3).unwrap()
}

/// Tokens and targets of a learnable function: a weighted sum of what the vertices hold.
fn examples() -> Examples {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut view = |count: usize| {
        let mut view = View::default();
        for _ in 0..count {
            let token = |_| std::array::from_fn(|_| random.random_range(-1.0_f32..1.0));
            let tokens: [[f32; 6]; VERTICES] = std::array::from_fn(token);
            view.inputs.extend(tokens.as_flattened());
            let sum = |k: usize| tokens.iter().map(|t| t[k] * (1.0 - t[3 + k].abs())).sum::<f32>() / 4.0;
            view.outputs.extend((0..3).map(sum));
        }
        view
    };
    Examples { training: vec![view(700)], validation: view(200) }
}

fn write(path: &std::path::Path, examples: &Examples, start: &[f32], optimiser: &Optimiser, config: &NetworkConfig) {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut put = |values: &[f32]| values.iter().for_each(|v| file.write_all(&v.to_le_bytes()).unwrap());
    let View { inputs, outputs } = &examples.training[0];
    let sizes = [outputs.len() / 3, examples.validation.outputs.len() / 3, start.len(), config.width, config.heads];
    put(&sizes.map(|s| s as f32));
    put(&[optimiser.epochs as f32, optimiser.batch as f32, optimiser.learning_rate as f32, optimiser.decay as f32]);
    [inputs, outputs, &examples.validation.inputs, &examples.validation.outputs].into_iter().for_each(|list| put(list));
    put(start);
}

fn against_pytorch() {
    let (examples, config) = (examples(), NetworkConfig::default());
    let optimiser = Optimiser { epochs: EPOCHS, ..Optimiser::default() };
    let network = Attention { config, inputs: 3, starts_at_zero: false };
    let device = Device::cpu();
    let training = Training::new(&network, &examples, &optimiser, 1, &device).unwrap();
    let start = training.start().unwrap();
    let path = std::env::temp_dir().join(format!("abbe-training-bench-{}.f32", std::process::id()));
    write(&path, &examples, &start.parameters, &optimiser, &config);
    let own = || {
        let mut run = start.clone();
        let begin = Instant::now();
        (0..EPOCHS).for_each(|_| training.epoch(&mut run).unwrap());
        (begin.elapsed().as_secs_f64() / EPOCHS as f64, run)
    };
    let python = ["ABBE_TORCH_PYTHON", "ABBE_PYTHON"].iter().find_map(|name| std::env::var(name).ok());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/pytorch_training.py");
    let rival = || Command::new(python.as_deref().unwrap_or("python3")).arg(script).arg(&path).output();
    // Interleaved: whatever else runs on the machine meets both.
    for _ in 0..3 {
        let (own_s, run) = own();
        let last = *run.validation_loss.last().unwrap();
        println!("burn: {:.1} ms an epoch, validation loss {last:.6} after {EPOCHS}", own_s * 1e3);
        match rival() {
            Ok(output) if output.status.success() => {
                let text = String::from_utf8_lossy(&output.stdout).into_owned();
                let numbers: Vec<f64> = text.split_whitespace().map(|w| w.parse().unwrap()).collect();
                let [epoch_s, loss, threads] = numbers[..] else { panic!("{text}") };
                let (time, quality) = (epoch_s / own_s, loss / last);
                println!(
                    "PyTorch, {threads} threads: {:.1} ms an epoch, loss {loss:.6}; ratios to burn: {time:.2}, {quality:.3}",
                    epoch_s * 1e3
                );
            }
            Ok(output) => println!("PyTorch was not compared: {}", String::from_utf8_lossy(&output.stderr).trim()),
            Err(error) => println!("PyTorch was not compared: {error}"),
        }
    }
    std::fs::remove_file(&path).unwrap();
}

/// A model of each kind; how well it is trained does not matter for its speed.
fn models() -> Vec<(ResidualMethod, ResidualModel)> {
    let field = field();
    let of = |method| {
        let mut config = Config { method, ..Config::default() };
        config.optimiser.epochs = 1;
        train(&field, &config, &Device::cpu(), None, &mut |_| Go::On).unwrap().model
    };
    [Method::Kriging, Method::Network, Method::KrigingNetwork, Method::PerceptronKriging]
        .map(of)
        .map(|model| (model.kind(), model))
        .into()
}

/// Percentiles of single predictions at points that the model has not seen before.
fn percentiles(models: &[(ResidualMethod, ResidualModel)]) {
    let points = random_points_m(20_000, 9);
    for (kind, model) in models {
        let time = |point: &nalgebra::Vector3<f64>| {
            let begin = Instant::now();
            black_box(model.predict(black_box(point.as_slice())));
            begin.elapsed().as_secs_f64() * 1e6
        };
        let mut times: Vec<f64> = points.iter().map(time).collect();
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[(times.len() as f64 * share) as usize];
        let p = [at(0.5), at(0.99), at(0.999)];
        println!("{}, cell search included: p50 {:.1} µs, p99 {:.1} µs, p99.9 {:.1} µs", kind.name(), p[0], p[1], p[2]);
    }
}

fn bench(criterion: &mut Criterion) {
    against_pytorch();
    let models = models();
    percentiles(&models);
    let config = NetworkConfig::default();
    let network = Attention { config, inputs: 3, starts_at_zero: false };
    let values = network.initial(&mut ChaCha8Rng::seed_from_u64(1));
    let parameters = Parameters::new(&config, 3, values.clone()).unwrap();
    let number = |i: usize, j: usize| if j < 6 { ((i * 6 + j) as f32).sin() } else { 0.0 };
    let tokens: [Token; VERTICES] = std::array::from_fn(|i| std::array::from_fn(|j| number(i, j)));
    let device = Device::cpu();
    let device = device.burn();
    let length = values.len();
    let tensor = Tensor::<1>::from_data(TensorData::new(values, [length]), device);
    let mut group = criterion.benchmark_group("one prediction");
    group.bench_function("burn, network alone", |b| {
        b.iter(|| {
            let input = TensorData::new(
                tokens.iter().flat_map(|token| token[..6].to_vec()).collect(),
                [1, network.input_size()],
            );
            network.forward(&tensor, Tensor::from_data(input, device)).into_data()
        });
    });
    group.bench_function("as printed, plain loops", |b| b.iter(|| forward(&config, &parameters, black_box(&tokens))));
    let folded = Folded::new(&config, &parameters);
    group.bench_function("folded, network alone", |b| b.iter(|| folded.evaluate(black_box(&tokens))));
    let points = random_points_m(1024, 5);
    for (kind, model) in &models {
        let mut next = points.iter().cycle();
        group.bench_function(format!("whole model: {}", kind.name()), |b| {
            b.iter(|| model.predict(next.next().unwrap().as_slice()));
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
