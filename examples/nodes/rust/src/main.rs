//! The same PD in Rust, over RustDDS: cargo run --release, beside trunk run SCENARIO --external.
use futures::StreamExt;
use ros2_client::{ros2, ros2::policy, Context, ContextOptions, Message, MessageTypeName, Name, NodeName, NodeOptions};
use serde::{Deserialize, Serialize};

const KP: f64 = 60.0; // N m/rad
const KD: f64 = 9.0; // N m s/rad
const LIMIT: f64 = 100.0; // N m

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Header {
    stamp: (i32, u32), // seconds, nanoseconds
    frame_id: String,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct JointState {
    header: Header,
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}
impl Message for JointState {}

fn main() {
    let domain = std::env::var("ROS_DOMAIN_ID").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
    let context = Context::with_options(ContextOptions::new().domain_id(domain)).expect("a DDS participant");
    let name = NodeName::new("/", "rust_pd").unwrap();
    let mut node = context.new_node(name, NodeOptions::new()).unwrap();
    let qos = ros2::QosPolicyBuilder::new()
        .history(policy::History::KeepLast { depth: 100 })
        .reliability(policy::Reliability::Reliable { max_blocking_time: ros2::Duration::from_millis(100) })
        .durability(policy::Durability::Volatile)
        .build();
    let topic = |name: &str| {
        let kind = MessageTypeName::new("sensor_msgs", "JointState");
        node.create_topic(&Name::new("/", name).unwrap(), kind, &qos).unwrap()
    };
    let (states, references, commands) = (topic("joint_states"), topic("reference"), topic("effort_command"));
    let commands = node.create_publisher::<JointState>(&commands, None).unwrap();
    let references = node.create_subscription::<JointState>(&references, None).unwrap();
    let states = node.create_subscription::<JointState>(&states, None).unwrap();
    smol::spawn(node.spinner().unwrap().spin()).detach(); // tells other nodes our name
    let (mut reference, mut ahead) = (0.0, std::collections::HashMap::new()); // rad; by stamp
    let mut stream = Box::pin(states.async_stream());
    while let Some(Ok((state, _))) = smol::block_on(stream.next()) {
        while let Ok(Some((message, _))) = references.take() {
            ahead.insert(message.header.stamp, message.position[0]);
        }
        reference = ahead.remove(&state.header.stamp).unwrap_or(reference);
        let Some(trunk) = state.name.iter().position(|joint| joint == "trunk") else { continue };
        let torque = (KP * (reference - state.position[trunk]) - KD * state.velocity[trunk]).clamp(-LIMIT, LIMIT);
        let header = Header { stamp: state.header.stamp, frame_id: String::new() };
        let command = JointState { header, name: vec!["trunk".into()], effort: vec![torque], ..Default::default() };
        commands.publish(command).expect("a command is sent");
    }
}
