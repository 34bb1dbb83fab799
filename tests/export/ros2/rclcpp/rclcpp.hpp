// A stand-in for rclcpp: as much as the node uses, with the same names and arguments. What the node publishes is kept,
// what it listens with can be called, and time is a number that somebody else (`world.cpp`) moves on.
#ifndef STAND_IN_RCLCPP_HPP
#define STAND_IN_RCLCPP_HPP

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "messages.hpp"

namespace stand_in {
inline std::map<std::string, std::string> arguments;  // parameters, and what the world is told
inline std::int64_t nanoseconds = 0;
inline std::function<void()> timer;
template <class Message>
inline std::shared_ptr<const Message> published;  // last
template <class Message>
inline std::function<void(std::shared_ptr<const Message>)> heard;

inline std::string argument(const std::string &name)
{
    const auto found = arguments.find(name);
    if (found == arguments.end())
        throw std::runtime_error("parameter '" + name + "' is not initialized");
    return found->second;
}
}  // namespace stand_in

namespace rclcpp {

class Duration {
public:
    explicit Duration(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
    static Duration from_seconds(double seconds) { return Duration(static_cast<std::int64_t>(seconds * 1e9)); }
    double seconds() const { return static_cast<double>(nanoseconds_) / 1e9; }

private:
    std::int64_t nanoseconds_;
};

class Time {
public:
    explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
    Time(const builtin_interfaces::msg::Time &stamp) : nanoseconds_(stamp.sec * second + stamp.nanosec) {}
    operator builtin_interfaces::msg::Time() const
    {
        return {static_cast<std::int32_t>(nanoseconds_ / second), static_cast<std::uint32_t>(nanoseconds_ % second)};
    }
    Duration operator-(const Time &other) const { return Duration(nanoseconds_ - other.nanoseconds_); }

private:
    static constexpr std::int64_t second = 1000000000;
    std::int64_t nanoseconds_;
};

class QoS {
public:
    QoS(std::size_t) {}
    QoS &transient_local() { return *this; }
};
struct SensorDataQoS : QoS {
    SensorDataQoS() : QoS(5) {}
};

struct Clock {
    using SharedPtr = std::shared_ptr<Clock>;
};
struct Logger {};
inline Logger get_logger(const std::string &) { return {}; }
struct TimerBase {
    using SharedPtr = std::shared_ptr<TimerBase>;
};
template <class Message>
struct Publisher {
    using SharedPtr = std::shared_ptr<Publisher>;
    void publish(const Message &message) { stand_in::published<Message> = std::make_shared<Message>(message); }
};
template <class Message>
struct Subscription {
    using SharedPtr = std::shared_ptr<Subscription>;
};

class Node {
public:
    explicit Node(const std::string &name) : name_(name) {}
    const char *get_name() const { return name_.c_str(); }
    const char *get_namespace() const { return "/"; }
    Logger get_logger() const { return {}; }
    Clock::SharedPtr get_clock() { return clock_; }
    Time now() const { return Time(stand_in::nanoseconds); }

    template <class Value>
    Value declare_parameter(const std::string &name)
    {
        const std::string text = stand_in::argument(name);
        if constexpr (std::is_same_v<Value, double>)
            return std::stod(text);
        else
            return text;
    }

    template <class Message>
    typename Publisher<Message>::SharedPtr create_publisher(const std::string &, const QoS &)
    {
        return std::make_shared<Publisher<Message>>();
    }

    template <class Message, class Callback>
    typename Subscription<Message>::SharedPtr create_subscription(const std::string &, const QoS &, Callback &&callback)
    {
        stand_in::heard<Message> = std::forward<Callback>(callback);
        return std::make_shared<Subscription<Message>>();
    }

private:
    std::string name_;
    Clock::SharedPtr clock_ = std::make_shared<Clock>();
};

template <class NodeT, class Callback>
TimerBase::SharedPtr create_timer(NodeT, Clock::SharedPtr, Duration, Callback &&callback)
{
    stand_in::timer = std::forward<Callback>(callback);
    return std::make_shared<TimerBase>();
}

inline void init(int count, char **arguments)
{
    for (int i = 1; i < count; i++) {
        const std::string text = arguments[i];
        stand_in::arguments[text.substr(0, text.find('='))] = text.substr(text.find('=') + 1);
    }
}
void spin(std::shared_ptr<Node> node);  // the world
inline void shutdown() {}

}  // namespace rclcpp

#define RCLCPP_FATAL(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__))
#define RCLCPP_ERROR_THROTTLE(logger, clock, milliseconds, ...) \
    ((void)(logger), (void)(clock), (void)(milliseconds), std::fprintf(stderr, __VA_ARGS__))

#endif
