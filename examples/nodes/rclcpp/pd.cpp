// The same PD with rclcpp. To be built in a workspace of your own; it was not run here.
#include <algorithm>
#include <map>
#include <memory>

#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/joint_state.hpp>

using sensor_msgs::msg::JointState;

class PD : public rclcpp::Node
{
public:
  PD() : Node("cpp_pd")
  {
    const auto reliable = rclcpp::QoS(100).reliable();
    command_ = create_publisher<JointState>("effort_command", reliable);
    references_ = create_subscription<JointState>(
      "reference", reliable, [this](const JointState & message) {
        ahead_[rclcpp::Time(message.header.stamp).nanoseconds()] = message.position.at(place(message));
      });
    states_ = create_subscription<JointState>(
      "joint_states", reliable, [this](const JointState & state) { answer(state); });
  }

private:
  static std::size_t place(const JointState & message)
  {
    const auto & name = message.name;
    return static_cast<std::size_t>(std::find(name.begin(), name.end(), "trunk") - name.begin());
  }

  void answer(const JointState & state)
  {
    const auto trunk = place(state);
    const auto found = ahead_.find(rclcpp::Time(state.header.stamp).nanoseconds());
    if (found != ahead_.end()) {reference_ = found->second;}
    const double torque =
      kp * (reference_ - state.position.at(trunk)) - kd * state.velocity.at(trunk);
    JointState command;
    command.header.stamp = state.header.stamp;
    command.name = {"trunk"};
    command.effort = {std::clamp(torque, -limit, limit)};
    command_->publish(command);
  }

  static constexpr double kp = 60.0, kd = 9.0, limit = 100.0;  // N m/rad, N m s/rad, N m
  double reference_ = 0.0;                                     // rad
  std::map<int64_t, double> ahead_;                            // by stamp, ns
  rclcpp::Publisher<JointState>::SharedPtr command_;
  rclcpp::Subscription<JointState>::SharedPtr references_, states_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<PD>());
  rclcpp::shutdown();
}
